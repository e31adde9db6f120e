"""The checker that jaxtyping applies to every annotated function during tests."""

from beartype import BeartypeConf, beartype

# Python's own rule (PEP 484): where a float is asked for, an int will do.
check = beartype(conf=BeartypeConf(is_pep484_tower=True))

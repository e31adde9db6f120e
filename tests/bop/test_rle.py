from contextlib import suppress

import numpy as np
import pycocotools.mask
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from simpick.bop.rle import compress_counts, decode_rle, decompress_counts, encode_compressed_rle, encode_rle
from simpick.errors import DatasetError

# Down the columns: 0 1 | 1 1 | 0 0 -> one 0, three 1, two 0.
MASK = np.array([[False, True, False], [True, True, False]])
COUNTS = [1, 3, 2]


def test_runs_go_down_the_columns_and_begin_with_background():
    assert encode_rle(MASK) == {"size": [2, 3], "counts": COUNTS}
    assert encode_rle(~MASK) == {"size": [2, 3], "counts": [0, 1, 3, 2]}
    assert encode_rle(np.zeros((2, 2), bool)) == {"size": [2, 2], "counts": [4]}
    assert encode_rle(np.ones((2, 2), bool)) == {"size": [2, 2], "counts": [0, 4]}


@pytest.mark.parametrize(
    ("counts", "text"),
    [
        (COUNTS, "132"),  # below 16 a count is one character from '0'
        ([15], "?"),
        ([16], "`0"),  # 16 has bit 4, the sign, so a second group of 0 follows: 16 + 32 + 48 = '`', then '0'
        ([100], "T3"),  # 100 = 4 + 3 * 32: 4 + 32 + 48 = 'T', 3 + 48 = '3'
        ([7, 5, 9, 5, 9], "75900"),  # from the fourth on, differences to the count two before
        ([7, 5, 9, 4], "759O"),  # -1 is 31 in 5 bits: 31 + 48 = 'O'
        ([7, 40, 9, 4], "7X19lN"),  # -36: low group 28 + 32 + 48 = 'l', then -2 = 30 + 48 = 'N'
    ],
)
def test_compressed_counts_match_the_hand_computed_text(counts, text):
    assert compress_counts(counts) == text
    assert decompress_counts(text, "here") == counts


def test_compressed_form_of_a_box():
    mask = np.zeros((480, 640), bool)
    mask[100:300, 200:500] = True
    # Written by pycocotools 2.0: the same run repeats 299 times, so differences are 0.
    assert encode_compressed_rle(mask) == {"size": [480, 640], "counts": "Tkm2X6h8" + "0" * 597 + "l`Q2"}


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_both_forms_agree_with_pycocotools_and_decode_to_the_mask(share):
    rng = np.random.default_rng(3)
    mask = rng.random((37, 53)) < share
    compressed = pycocotools.mask.encode(np.asfortranarray(mask.astype(np.uint8)))
    assert encode_compressed_rle(mask)["counts"].encode() == compressed["counts"]
    np.testing.assert_array_equal(decode_rle(encode_rle(mask), 37, 53, "here"), mask)
    np.testing.assert_array_equal(decode_rle(encode_compressed_rle(mask), 37, 53, "here"), mask)


def test_a_mask_of_another_size_is_refused():
    with pytest.raises(
        DatasetError, match=r"f\.json, entry 3: the RLE's size is \[2, 3\], but the image's is \[48, 64\]"
    ):
        decode_rle(encode_rle(MASK), 48, 64, "f.json, entry 3")


@pytest.mark.parametrize(
    ("rle", "text"),
    [
        (
            {"size": [2, 3], "counts": [1, 3]},
            r"2 x 3 = 6 pixels, got a smallest of 1 and a sum of 4; the file is damaged",
        ),
        ({"size": [2, 3], "counts": [9, -3]}, r"got a smallest of -3 and a sum of 6"),
        # In 64 bits these add up to 6, and np.repeat writes beyond its array.
        ({"size": [2, 3], "counts": [2**62, 2**62, 2**62, 2**62 + 6]}, r"and a sum of 18446744073709551622;"),
        ({"size": [2, 3], "counts": [2**70, 6 - 2**70]}, r"a smallest of -1180591620717411303418"),
        ({"size": [2, 3], "counts": [1.0, 5.0]}, r"counts must be whole numbers or their text, got \[1.0, 5.0\]"),
        ({"size": [2, 3], "counts": [True, 5]}, r"counts must be whole numbers or their text, got \[True, 5\]"),
        ({"size": [2, 3], "counts": None}, r"counts must be whole numbers or their text, got None"),
        ({"size": None, "counts": [6]}, r"the RLE's size is None, but the image's is \[2, 3\]"),
        ({"size": [2, 3], "counts": "o" * 99}, r"a count beyond any image; the file is damaged"),
        ({"size": [2, 3], "counts": "13 "}, r"' ' cannot occur in a compressed RLE"),
        ({"size": [2, 3], "counts": "13T"}, r"ends within a number; the file is truncated"),
        ([[1, 2, 3, 4]], r"a segmentation must be RLE with 'size' and 'counts', got \[\[1, 2, 3, 4\]\]"),
    ],
)
def test_broken_encodings_are_refused(rle, text):
    with pytest.raises(DatasetError, match=text):
        decode_rle(rle, 2, 3, "here")


@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=12)))
def test_every_mask_survives_both_forms(mask):
    for encode in (encode_rle, encode_compressed_rle):
        np.testing.assert_array_equal(decode_rle(encode(mask), mask.shape[0], mask.shape[1], "here"), mask)


COUNT = st.one_of(st.integers(0, 8), st.integers(-(2**65), 2**65), st.floats(), st.none(), st.booleans())
ENTRIES = st.one_of(st.lists(COUNT, max_size=6), st.text(max_size=30), st.text(st.characters(max_codepoint=127)))


@given(ENTRIES, st.one_of(st.just([2, 3]), st.lists(st.integers(), max_size=3), st.none()))
def test_any_encoding_gives_a_mask_of_the_image_s_size_or_an_error(counts, size):
    with suppress(DatasetError):
        mask = decode_rle({"size": size, "counts": counts}, 2, 3, "here")
        assert mask.shape == (2, 3)
        assert mask.dtype == bool

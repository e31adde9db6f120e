"""COCO's run-length encoding of masks, plain and compressed.

Pixels are counted down the columns (column-major). The counts alternate between background and foreground and
begin with background, so a mask whose first pixel is set begins with 0. The compressed form is the same list as
text: each count from the fourth on is written as its difference to the count two before it, in groups of 5 bits,
lowest first; bit 5 of a character marks that more groups follow, bit 4 of the last is the sign, and 48 is added to
make it printable (pycocotools, ``common/maskApi.c``, ``rleToString`` and ``rleFrString``).

pycocotools is the test oracle. It is not used here because it trusts its input: for counts that end early it returns
uninitialized memory, and text that ends within a number corrupts the heap. It also decodes 3 to 7 times as slowly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool

from simpick.errors import DatasetError

_MOST_BITS = 60
"""A count of more is none of pixels; without a limit, damaged text would build numbers without end."""


def encode_rle(mask: Bool[np.ndarray, "height width"]) -> dict[str, Any]:
    """Return the plain form: ``{"size": [height, width], "counts": [...]}``."""
    pixels = mask.ravel(order="F")
    edges = np.flatnonzero(np.diff(pixels)) + 1
    counts = np.diff(np.concatenate([[0], edges, [pixels.size]])).tolist()
    return {"size": list(mask.shape), "counts": [0, *counts] if pixels.size and pixels[0] else counts}


def encode_compressed_rle(mask: Bool[np.ndarray, "height width"]) -> dict[str, Any]:
    """Return the compressed form: ``{"size": [height, width], "counts": "..."}``."""
    rle = encode_rle(mask)
    return {"size": rle["size"], "counts": compress_counts(rle["counts"])}


def decode_rle(rle: Any, height: int, width: int, where: str) -> Bool[np.ndarray, "height width"]:
    """Return the mask of either form; `where` names the entry in errors.

    Raises `DatasetError` if the encoding is invalid or belongs to an image of another size.
    """
    if not isinstance(rle, dict) or "size" not in rle or "counts" not in rle:
        raise DatasetError(f"{where}: a segmentation must be RLE with 'size' and 'counts', got {str(rle)[:60]}.")
    size = rle["size"]
    if not isinstance(size, list) or size != [height, width]:
        raise DatasetError(
            f"{where}: the RLE's size is {size!r:.60}, but the image's is [{height}, {width}] (height, width); "
            "the detections belong to other images, or were made at another scale."
        )
    counts = rle["counts"]
    if isinstance(counts, str):
        counts = decompress_counts(counts, where)
    if not isinstance(counts, list) or any(type(count) is not int for count in counts):
        raise DatasetError(f"{where}: the RLE's counts must be whole numbers or their text, got {counts!r:.60}.")
    # Summed as Python integers: in 64 bits, counts can wrap around to the right sum, and np.repeat trusts them.
    if min(counts, default=0) < 0 or sum(counts) != height * width:
        raise DatasetError(
            f"{where}: the RLE's counts must be 0 or more and add up to {height} x {width} = {height * width} pixels, "
            f"got a smallest of {min(counts, default=0)} and a sum of {sum(counts)}; the file is damaged."
        )
    return np.repeat(np.arange(len(counts)) % 2 == 1, counts).reshape((height, width), order="F")


def compress_counts(counts: list[int]) -> str:
    """Return the compressed text of plain counts."""
    characters: list[str] = []
    for k, count in enumerate(counts):
        value = count - counts[k - 2] if k > 2 else count
        more = True
        while more:
            group = value & 0x1F
            value >>= 5
            more = value != (-1 if group & 0x10 else 0)
            characters.append(chr((group | 0x20 if more else group) + 48))
    return "".join(characters)


def decompress_counts(text: str, where: str) -> list[int]:
    """Return the plain counts of a compressed text."""
    counts: list[int] = []
    value = shift = 0
    for character in text:
        group = ord(character) - 48
        if not 0 <= group < 64:
            raise DatasetError(f"{where}: {character!r} cannot occur in a compressed RLE; the file is damaged.")
        value |= (group & 0x1F) << shift
        shift += 5
        if shift > _MOST_BITS:
            raise DatasetError(f"{where}: the compressed RLE holds a count beyond any image; the file is damaged.")
        if not group & 0x20:
            if group & 0x10:
                value -= 1 << shift
            counts.append(value + counts[-2] if len(counts) > 2 else value)
            value = shift = 0
    if shift:
        raise DatasetError(f"{where}: the compressed RLE ends within a number; the file is truncated.")
    return counts

"""What a vision-language model is asked (paper appendix C, figure A.2), and its answer taken apart."""

from __future__ import annotations

import base64
import json
import string
import struct
import zlib
from typing import Any

import numpy as np

from ..errors import InputError
from ..types import object_mask
from .database import materials
from .endpoint import Message
from .records import DENSITY_RANGE, POISSON_RANGE, YOUNG_RANGE, Record, of_model

FENCE = "```"
MOST_RECORDS = 32
LARGEST_SIDE = 768  # px: more shows a model nothing that tells materials apart
BACKDROP = 127  # grey of what is not the object
TINTS = np.array([[230, 60, 60], [60, 140, 230], [70, 190, 80], [240, 180, 40], [170, 80, 210], [60, 200, 200], [240, 120, 180], [140, 110, 70]])

CONTRACT = """\
You see one object on a grey background. Name each part of it that is made of one material and estimate the material's constants.
Answer with a JSON array and nothing else, one object per part, with exactly these keys:
  "name": short name of the part,
  "box": [left, top, right, bottom] around the part, each as a share of the image's width or height in 0 .. 1, top left is [0, 0],
  "material": the material, if it fits one of: {names},
  "E": Young's modulus in Pa, {young},
  "nu": Poisson's ratio, {poisson},
  "rho": density in kg/m^3, {density}.
Orders of magnitude: {examples}.
Hollow, porous or thin-walled parts count as the solid that would behave alike. Every part of the object lies in a box."""
MASKS = """
The second image shows {parts} masks of the object in colours: {colours}. Where a part of yours is one of them, add
  "part": the number of the mask."""
COLOUR_NAMES = ("red", "blue", "green", "yellow", "purple", "cyan", "pink", "brown")
EXAMPLES = ("rubber", "wood", "ceramic", "steel", "soft tissue", "green stem", "petal", "polyurethane foam")


def question(frame: np.ndarray, labels: np.ndarray) -> list[Message]:
    """The first message of the chat about frame 0 (H, W, 3) uint8 RGB with its label image (H, W)."""
    body = object_mask(labels)
    images = [np.where(body[..., None], frame, BACKDROP).astype(np.uint8)]
    parts = int(labels[body].max(initial=0))
    if parts > 1:
        images.append(np.where(body[..., None], TINTS[(labels - 1) % len(TINTS)], BACKDROP).astype(np.uint8))
    content: list[dict[str, Any]] = [{"type": "text", "text": _words(parts)}]
    content += [{"type": "image_url", "image_url": {"url": data_url(_reduced(image))}} for image in images]
    return [{"role": "user", "content": content}]


def again(answer: str, error: str) -> list[Message]:
    """The messages that follow an answer that breaks the contract."""
    said = f"This answer cannot be used. {error}. Answer again with the whole corrected JSON array and nothing else."
    return [{"role": "assistant", "content": answer}, {"role": "user", "content": said}]


def records_of(answer: str, *, parts: int) -> list[Record]:
    """The records of an answer, which may stand in a Markdown fence. Raises InputError that the model can act on."""
    entries = _array(answer)
    if not 1 <= len(entries) <= MOST_RECORDS:
        raise InputError(f"The array holds {len(entries)} objects, must hold 1 to {MOST_RECORDS}; give one per part")
    return [of_model(entry, f"Object {i + 1}", parts=parts) for i, entry in enumerate(entries)]


def data_url(image: np.ndarray) -> str:
    """An RGB image (H, W, 3) uint8 as a PNG in a data URL."""
    return "data:image/png;base64," + base64.b64encode(_png(image)).decode()


def _words(parts: int) -> str:
    examples = ", ".join(f"{name} E {m.young.typical:.0e} nu {m.poisson.typical:g} rho {m.density.typical:g}" for name, m in materials().items() if name in EXAMPLES)
    spans = (f"{low:g} .. {high:g}" for low, high in (YOUNG_RANGE, POISSON_RANGE, DENSITY_RANGE))
    young, poisson, density = spans
    text = CONTRACT.format(names=", ".join(materials()), young=young, poisson=poisson, density=density, examples=examples)
    if parts < 2:
        return text
    colours = ", ".join(f"{k + 1} {COLOUR_NAMES[k % len(TINTS)]}" for k in range(parts))
    return text + MASKS.format(parts=parts, colours=colours)


def _array(answer: str) -> list[Any]:
    try:
        found = json.loads(_unfenced(answer))
    except (ValueError, RecursionError) as error:
        raise InputError(f"It is not valid JSON ({str(error)[:120]})") from error
    if not isinstance(found, list):
        raise InputError(f"It is a JSON {type(found).__name__}, must be an array of objects")
    return found


def _unfenced(answer: str) -> str:
    """What stands in the first Markdown fence without the name of its language; the whole answer where there is none."""
    _, begin, rest = answer.partition(FENCE)
    inside, end, _ = rest.partition(FENCE)
    return inside.lstrip(string.ascii_letters) if begin and end else answer


def _reduced(image: np.ndarray) -> np.ndarray:
    step = -(-max(image.shape[:2]) // LARGEST_SIDE)
    return image[::step, ::step]


def _png(image: np.ndarray) -> bytes:
    """A PNG of an RGB image: signature, header, the rows each without a filter, end (ISO/IEC 15948)."""
    height, width = image.shape[:2]
    rows = np.concatenate([np.zeros((height, 1), np.uint8), np.ascontiguousarray(image).reshape(height, -1)], 1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pieces = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in pieces)

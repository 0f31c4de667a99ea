"""Pictures of a body: where programs differ from the truth, slice by slice and cut lengthwise."""

import numpy as np
from PIL import Image, ImageDraw

from . import bodies, measures, programs

#: Right inside, wrongly inside, wrongly outside; outside is white.
COLOURS = {(True, True): (150, 160, 170), (True, False): (214, 96, 0), (False, True): (0, 96, 190)}
PIXELS = 3
SLICES = 7


def tile(mask, truth, height):
    """One image of a plane, enlarged, `height` image rows for each row of it."""
    out = np.full((*mask.shape, 3), 255, np.uint8)
    for (inside, wanted), colour in COLOURS.items():
        out[(mask == inside) & (truth == wanted)] = colour
    return np.repeat(np.repeat(out, height, 0), PIXELS, 1)


def draw(number, only, folder):
    """Writes body-K.png: a row for each program, with the slices of most wrong pixels of all, then a cut along z. Gives its path."""
    body = bodies.body(number)
    truth, (dz, dy, dx) = body.truth, body.given.spacing
    masks = {name: programs.mask_of(programs.PROGRAMS[name][0](body.given)) for name in only or programs.PROGRAMS}
    wrong = sum((mask != truth).sum((1, 2)) for mask in masks.values())
    slices = sorted(np.argsort(-wrong, kind="stable")[:SLICES])
    row = int(np.argmax(sum((mask != truth).sum((0, 2)) for mask in masks.values())))
    rows = []
    for name, mask in masks.items():
        parts = [tile(mask[z], truth[z], max(round(PIXELS * dy / dx), 1)) for z in slices]
        parts.append(tile(mask[:, row], truth[:, row], max(round(PIXELS * dz / dx), 1)))
        tall = max(len(part) for part in parts) + 18
        parts = [np.pad(part, ((18, tall - 18 - len(part)), (0, 6), (0, 0)), constant_values=235) for part in parts]
        image = Image.fromarray(np.concatenate(parts, 1))
        score = measures.dice(truth, mask, body.given.places)
        words = f"{name}: Dice {score:.4f}   body {number}, {body.kind}; slices {', '.join(map(str, slices))}; given {', '.join(map(str, body.given.places))}"
        ImageDraw.Draw(image).text((4, 3), words, fill=(0, 0, 0))
        rows.append(np.asarray(image))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"body-{number}.png"
    Image.fromarray(np.concatenate(rows, 0)).save(path)
    return path

"""The blocks of docs/evaluation.md that are made of results.csv, and whether they still are. Python's standard library is enough.

A block lies between `<!-- evaluation:NAME -->` and `<!-- /evaluation:NAME -->`. The digest in `<!-- evaluation of ... -->` is that of results.csv, the
figures and all blocks.
"""

import hashlib
import re
import sys
from pathlib import Path

from .results import FOLDER, RESULTS

PAGE = FOLDER.parent.parent / "docs" / "evaluation.md"
BLOCK = re.compile(r"(<!-- evaluation:(\w+) -->\n)(.*?)(<!-- /evaluation:\2 -->)", re.DOTALL)
DIGEST = re.compile(r"<!-- evaluation of (\w*) -->")


def figures():
    return sorted(Path(FOLDER).glob("*.svg"))


def digest(text):
    """Of results, figures and the page's blocks."""
    found = hashlib.blake2b(digest_size=8)
    for path in [RESULTS, *figures()]:
        found.update(path.name.encode() + b"\n" + path.read_bytes())
    for block in BLOCK.finditer(text):
        found.update(block[0].encode())
    return found.hexdigest()


def write(blocks):
    """Puts text into the page's blocks, by their names, and the digest beneath."""
    text = PAGE.read_text()
    there = {block[2] for block in BLOCK.finditer(text)}
    if there != set(blocks) or len(DIGEST.findall(text)) != 1:
        raise SystemExit(f"{PAGE}: it has the blocks {sorted(there)}, and should have {sorted(blocks)}, and one digest")
    text = BLOCK.sub(lambda block: f"{block[1]}{blocks[block[2]].strip()}\n{block[4]}", text)
    PAGE.write_text(DIGEST.sub(f"<!-- evaluation of {digest(text)} -->", text))


def check():
    """Ends where the page is not that of results and figures."""
    text = PAGE.read_text()
    said = DIGEST.findall(text)
    if said != [digest(text)]:
        sys.exit(f"{PAGE}: its tables or figures are not those of {RESULTS.name}; benches/evaluation/run --tables makes them anew")
    print(f"{PAGE.name} is that of {RESULTS.name}: {len(BLOCK.findall(text))} blocks, {len(figures())} figures")


if __name__ == "__main__":
    check()

"""The blocks of docs/evaluation.md and README.md that are made of the files of results, and whether they still are. Python's standard library is enough.

A block lies between `<!-- evaluation:NAME -->` and `<!-- /evaluation:NAME -->`. The digest in `<!-- evaluation of ... -->`, in docs/evaluation.md, is that of
the files of results, the figures and all blocks.
"""

import hashlib
import re
import sys
from pathlib import Path

from .results import BODIES, FOLDER, TERRAIN, VOLUMES

ROOT = FOLDER.parent.parent
PAGES = (ROOT / "docs" / "evaluation.md", ROOT / "README.md")
BLOCK = re.compile(r"(<!-- evaluation:(\w+) -->\n)(.*?)(<!-- /evaluation:\2 -->)", re.DOTALL)
DIGEST = re.compile(r"<!-- evaluation of (\w*) -->")


def sources():
    """Files of results and figures."""
    return [*(results.path for results in (BODIES, TERRAIN, VOLUMES)), *sorted(Path(FOLDER).glob("*.svg"))]


def digest(texts):
    """Of results, figures and the pages' blocks."""
    found = hashlib.blake2b(digest_size=8)
    for path in sources():
        found.update(path.name.encode() + b"\n" + path.read_bytes())
    for text in texts:
        for block in BLOCK.finditer(text):
            found.update(block[0].encode())
    return found.hexdigest()


def write(blocks):
    """Puts text into the pages' blocks, by their names, and the digest beneath."""
    texts = [page.read_text() for page in PAGES]
    there = sorted(block[2] for text in texts for block in BLOCK.finditer(text))
    if there != sorted(blocks) or [len(DIGEST.findall(text)) for text in texts] != [1, 0]:
        names = " and ".join(page.name for page in PAGES)
        raise SystemExit(f"{names}: they have the blocks {there}, and should have {sorted(blocks)}, and one digest in {PAGES[0].name}")
    texts = [BLOCK.sub(lambda block: f"{block[1]}{blocks[block[2]].strip()}\n{block[4]}", text) for text in texts]
    texts[0] = DIGEST.sub(f"<!-- evaluation of {digest(texts)} -->", texts[0])
    for page, text in zip(PAGES, texts):
        page.write_text(text)


def check():
    """Ends where the pages are not those of results and figures."""
    texts = [page.read_text() for page in PAGES]
    said = [word for text in texts for word in DIGEST.findall(text)]
    if said != [digest(texts)]:
        names = ", ".join(path.name for path in sources())
        sys.exit(f"{PAGES[0]} or {PAGES[1].name}: tables are not those of {names}; benches/evaluation/run --tables makes them anew")
    count = sum(len(BLOCK.findall(text)) for text in texts)
    print(f"{' and '.join(page.name for page in PAGES)} are those of the results: {count} blocks of {len(sources())} files")


if __name__ == "__main__":
    check()

"""Pages and words of the documentation: `python docs/count_words.py`.

What a program writes (configuration, HTTP API, names of the Python interface) is counted apart.
"""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parent
GENERATED = re.compile(r"<!-- .*?by `python docs/reference\.py` -->.*?<!-- end .*?-->", re.DOTALL)


def words(text: str) -> int:
    return len(text.split())


def main() -> None:
    by_hand = generated = 0
    pages = sorted(DOCS.glob("*.md"))
    for path in pages:
        text = path.read_text(encoding="utf-8")
        own = words(GENERATED.sub("", text))
        by_hand, generated = by_hand + own, generated + words(text) - own
        print(f"{path.name:28} {own:6}")
    print(f"{len(pages)} pages, {by_hand} words by hand, {generated} words by the program")


if __name__ == "__main__":
    main()

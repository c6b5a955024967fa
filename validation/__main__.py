"""`make validate`: solve the contacts, then write docs/validation.md, its table and its
pictures; and docs/voltage-law.md, alone with `voltage`. Their tables are printed too.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from validation import voltage

DOCS = Path(__file__).parents[1] / "docs"
THREADS = 2


def main() -> int:
    """Exit status 1 where model/contact/theory_error.py claims less than this run found."""
    show(voltage.write(DOCS))
    return 0 if sys.argv[1:] == ["voltage"] else _contacts()


def show(page: Path) -> None:
    """Print the headings and tables of a page."""
    kept = (line for line in page.read_text().splitlines() if line.startswith(("#", "|")))
    sys.stdout.write("\n".join((f"{page.name}", *kept, "")))


def _contacts() -> int:
    import tamaas  # noqa: PLC0415 - only this extra has it

    from validation import report, study  # noqa: PLC0415

    tamaas.initialize(THREADS)
    tamaas.set_log_level(tamaas.LogLevel.warning)
    start = time.monotonic()

    def tell(step: str) -> None:
        sys.stderr.write(f"{time.monotonic() - start:6.0f} s  {step}\n")

    rows, shares = study.run(tell)
    study.write_rows(rows, DOCS / "validation.csv")
    report.write(rows, shares, DOCS)
    show(DOCS / "validation.md")
    sys.stdout.write(f"{len(rows)} contacts compared\n")
    for line in report.disagreements(rows):
        sys.stdout.write(f"model/contact/theory_error.py claims less than this run found: {line}\n")
    return 1 if report.disagreements(rows) else 0


if __name__ == "__main__":
    sys.exit(main())

"""What `haptic load tune` writes down: the finger's stiffness, who found it and when."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

from pydantic import Field

from haptic_driver.config import Section, Within, parse
from haptic_driver.files import write_text
from model.support.reading import read_toml
from model.support.toml import toml_lines

Stiffness = Annotated[float, Within(10.0, 1e5, "no fingertip is softer or stiffer")]


class LoadGains(Section):
    """A file of its own, which `load_stage.gains_file` names."""

    stiffness_n_per_m: Stiffness = Field(description="of the finger at 0.5 N")
    spread_n_per_m: Annotated[float, Within(0.0, 1e6, "it is a spread")] = Field(
        description="of the steps, 1 sigma"
    )
    tuned_by: Annotated[str, Field(min_length=1)] = Field(description="who found it")
    tuned_at: datetime.date = Field(description="when")

    def write(self, path: Path) -> None:
        """Over what was there."""
        said = {
            **self.model_dump(),
            "stiffness_n_per_m": float(f"{self.stiffness_n_per_m:.3g}"),
            "spread_n_per_m": float(f"{self.spread_n_per_m:.2g}"),
        }
        write_text(path, "# Written by haptic load tune.\n" + toml_lines(said))


def read_gains(path: Path) -> LoadGains | None:
    """BadInputError says what is wrong with the file; None where there is none yet."""
    return parse(LoadGains, read_toml(path), str(path)) if path.exists() else None

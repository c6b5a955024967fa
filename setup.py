"""What pyproject.toml cannot say: a wheel carries `configs/` and the commit that it was built from.

They land inside the package, where `haptic_driver.config.config_dirs` and `haptic --version` look;
a checkout and an editable install use the repository's own folder and git.
"""

import shutil
import subprocess
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent


class BuildWithConfigs(build_py):
    """The Python files, then the rest."""

    def run(self) -> None:
        """Copy into the folder that becomes the wheel."""
        super().run()
        if self.editable_mode:
            return
        package = Path(self.build_lib) / "haptic_driver"
        shutil.rmtree(package / "configs", ignore_errors=True)
        shutil.copytree(ROOT / "configs", package / "configs")
        if commit := _commit():
            (package / "commit.txt").write_text(commit + "\n", encoding="ascii")


def _commit() -> str:
    """The short hash of the checkout; empty outside of one."""
    if not (ROOT / ".git").exists():
        return ""
    try:
        done = subprocess.run(
            ["git", "rev-parse", "--short=12", "HEAD"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError:
        return ""
    return done.stdout.strip()


setup(cmdclass={"build_py": BuildWithConfigs})

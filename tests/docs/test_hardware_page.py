"""The device with calls instead of a wire that the page about hardware shows runs as it stands."""

import re
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs" / "hardware.md"


def test_the_made_up_sdk_drives_a_carrier(capsys):
    blocks = re.findall(
        r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    (code,) = [block for block in blocks if "class SdkOutput" in block]
    exec(compile(code, str(PAGE), "exec"), {})
    rate, on, off = capsys.readouterr().out.splitlines()
    assert "asked=48000.0, got=50000.0" in rate
    assert on == "True 1.20 V"
    assert off == "True"

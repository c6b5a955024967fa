"""How long an example takes says what the machine had to do meanwhile, not whether the program is right."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

settings.register_profile(
    "project",
    settings.default,  # with what hypothesis itself changes in continuous integration
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("project")

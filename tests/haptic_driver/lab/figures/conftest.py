"""The shipped models and reference values, as the tests of the physics have them."""

from tests.model.conftest import fresh_tables, models, reference

__all__ = ["fresh_tables", "models", "reference"]

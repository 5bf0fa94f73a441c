"""What the benches take from the tests: rigs, scenes and settings, so that both mean the same."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def module_of_the_tests(path: str) -> ModuleType:
    """The module at a path below `test/`, as `optics/conftest.py`."""
    place = Path(__file__).parents[1] / 'test' / path
    name = f'of_the_tests_{place.parent.name}_{place.stem}'
    spec = importlib.util.spec_from_file_location(name, place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up while they are made.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module

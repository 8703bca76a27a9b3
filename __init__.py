"""The folder of a clone that is called photogram, found before the package by a script beside it: gives the package."""

import importlib
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
del sys.modules[__name__]
sys.modules[__name__] = importlib.import_module("photogram")

"""Where data lie that are not part of the repository."""

import os
from pathlib import Path

SHARED_DATA = Path(os.environ.get("PHOTOGRAM_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data")).resolve()
"""``shared/data`` beside the repository, or the folder that the environment names; see CONTRIBUTING.md."""

"""The libraries of the desk's map, taken from their packages.

    python tests/vendored.py

downloads the versions of PACKAGES by `npm pack` and copies their files, with their licences, into the page of the desk.
"""

import subprocess
import tarfile
import tempfile
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "photogram" / "desk" / "static" / "vendor"
PACKAGES = {
    "ol@10.11.0": {"dist/ol.js": "ol.js", "ol.css": "ol.css", "LICENSE.md": "ol-LICENSE.txt"},
    "geotiff@3.1.0-beta.0": {"dist-browser/geotiff.js": "geotiff.js", "LICENSE": "geotiff-LICENSE.txt"},
}
"""Of each package, the version that OpenLayers asks for, its files and what they are called here."""

_MAP = b"//# sourceMappingURL="


def main() -> None:
    """Copy the files, without the references to maps of their sources, which are not copied."""
    for package, files in PACKAGES.items():
        with tempfile.TemporaryDirectory() as folder:
            call = ["npm", "pack", "--silent", "--pack-destination", folder, package]
            subprocess.run(call, check=True)
            (archive,) = Path(folder).glob("*.tgz")
            with tarfile.open(archive) as held:
                for name, called in files.items():
                    member = held.extractfile(f"package/{name}")
                    assert member is not None, f"{package} has no {name}"
                    content = member.read()
                    start = content.rfind(_MAP)
                    (FOLDER / called).write_bytes(content if start < 0 else content[:start])


if __name__ == "__main__":
    main()

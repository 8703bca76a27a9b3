"""Bundle-adjustment photogrammetry: photographs and ground control to a surface model that says how good it is."""

__version__ = "0.1.0"

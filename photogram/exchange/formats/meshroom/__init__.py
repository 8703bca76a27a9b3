"""Solutions of Meshroom: its scenes as JSON, and the text of its bundle adjustment.

Follows no path of a file, and reads no picture.
`meshroom.read_meshroom`, `meshroom_baf.read_meshroom_baf`.
"""

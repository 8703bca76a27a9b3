"""The surface with the orthophoto on it, in three dimensions, for viewers that know no survey.

`glb_model`: one file to look at. `gltf` writes what it is given as binary glTF, `draped_mesh` makes the meshes.
"""

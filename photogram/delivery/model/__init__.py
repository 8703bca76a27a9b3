"""The surface with the orthophoto on it, in three dimensions, for viewers that know no survey.

Knows nothing of stages: it is given files of heights and of the orthophoto, and makes them no better than they are.
`glb_model.write_model` for one file to look at; `draped_mesh` makes the meshes, `gltf` writes them.
"""

"""The surface with the orthophoto on it in levels of detail, for globes: 3D Tiles 1.1.

Holds one tile at a time, whatever the size of the survey; heights are those of cells, none is averaged.
`tileset.write_tileset`; `tile_mesh` makes the mesh of a tile, `quadtree` says which cells it has.
"""

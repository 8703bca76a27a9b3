"""COLMAP's sparse models, read and written, and its databases, read.

Holds what COLMAP's files hold as they hold it; of a database nothing is run.
`sparse_models.read_colmap`, `sparse_models.write_colmap` and `database.read_colmap_database`.
"""

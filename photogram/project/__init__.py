"""project.yaml: read, checked against itself, and turned into a block with its measurements.

Opens no photograph for its pixels and starts no processing.
`project.read_project`, `measured`; `draft` writes projects, `validation` tests them.
"""

"""Clouds handed over for viewers that load the part they show.

Makes no points: they are those of the surface that the survey has matched.
`copc_cloud.write_copc_cloud` writes dense.copc.laz.
"""

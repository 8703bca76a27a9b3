"""Solutions of Agisoft Metashape and PhotoScan: projects, and the XML of exported cameras.

Unpacks no more than a project may hold, follows no path out of it, and swaps p1 and p2 once.
`metashape_project.read_metashape_project`, `metashape_cameras.read_metashape_cameras`; `metashape_chunk` is common.
"""

"""Solutions of Pix4D's programs: the Open Photogrammetry Format, and the folder params of PIX4Dmapper.

Opens no file outside of the project's folder; keeps map coordinates in full, whatever the project is shifted by.
`opf.read_opf`, `opf.write_opf`, `pix4d_params.read_pix4d_params`; `opf_tracks` has the tie points.
"""

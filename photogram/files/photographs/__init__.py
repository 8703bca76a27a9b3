"""Photographs on disk: pixels, headers, EXIF and XMP tags, copies of the same photograph, previews.

Opens an explicit list of formats; interprets no tag further than its unit.
`images.read_photograph`, `images.read_tags`.
"""

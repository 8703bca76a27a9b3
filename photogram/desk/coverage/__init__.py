"""What the photographs of a folder cover before anything is matched, from the positions and attitudes in their tags.

Decodes no photograph and decides nothing of the survey. `coverage.coverage`, `field_check.count_views`,
`tagged_flight.tagged_flight`, `overlaps.overlaps`.
"""

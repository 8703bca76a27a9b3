"""The numbers of report.json, section by section, and the verdict on them.

Reads results and writes none; draws nothing.
`numbers` makes the report; `overall` and `traffic_lights` grade it.
"""

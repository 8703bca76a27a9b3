"""The 3-D page view.html: what it shows of cloud, surface, photographs and ground points, packed into one file.

Opens rasters of the surface window by window, and no other file; draws nothing itself, scripts of `templates/` do that.
`viewer.view_page` makes the page of what the others hand it.
"""

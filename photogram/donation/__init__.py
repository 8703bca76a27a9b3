"""Donation: what a survey measured, without photographs, names, dates and place, as one small file to give away.

Nothing is sent; the engine does not know of it. `donation.donated` makes one of a finished survey,
`donation.read_donation` reads it, and its block can be adjusted again as it is.
"""

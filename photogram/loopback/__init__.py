"""Pages of this machine for its own browser: who is answered, and how.

A page is a list of addresses; the server gives them to whoever has its token, on the loopback alone. Knows nothing of
what the pages show.
"""

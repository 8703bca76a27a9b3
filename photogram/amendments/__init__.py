"""What may enter the model of a block or leave it: each amendment a file, proposed, adjusted and judged in one loop.

Estimates nothing itself, and no amendment knows of another; `amendment.amended` is the loop.
`snooped_adjustment.adjust_with_snooping`.
"""

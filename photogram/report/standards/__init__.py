"""What an authority asks of a survey: figures of report.json mapped to its classes or statements.

States a class from check points alone, and only where there are enough of them; measures nothing anew.
`authorities.standard_record`.
"""

"""Solutions of the Damped Bundle Adjustment Toolbox (DBAT): its result file, its script, and the tables of that.

Opens nothing but files beside the result file, whatever paths it and the script name.
`dbat.read_dbat`; `dbat_report` reads the result file, `dbat_script` the script and its tables.
"""

"""One page for a whole survey, in the browser of this machine: from a folder of photographs to what is handed over.

Computes nothing itself: it writes the project file, starts the same commands and reads the same files as a terminal.
`command.desk`, `server.DeskServer`, `survey_folder.SurveyFolder`.
"""

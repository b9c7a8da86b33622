"""The sections of the reports: one file, and one template under ``templates/``, each."""

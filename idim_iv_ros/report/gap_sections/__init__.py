"""The sections of the diagnosis report, one file each: a function from the result to HTML."""

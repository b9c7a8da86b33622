"""Files and pages made of a result."""

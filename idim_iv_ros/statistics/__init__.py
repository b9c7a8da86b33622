"""May the estimates be believed: instruments, exogeneity, residuals and the verdict."""

"""The diagnosis on robots and recordings as hostile as the world; see its README."""

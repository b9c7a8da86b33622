"""Bags: MCAP files, SQLite files and folders of either, read without objects per message."""

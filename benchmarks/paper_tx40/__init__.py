"""Section V of the founding paper on a simulated TX40: tables, figures and sentences."""

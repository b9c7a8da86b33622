"""What an identified model predicts of the efforts while the robot runs."""

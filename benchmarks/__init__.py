"""Speed and memory against peers; each module prints ratios and keeps them in results/."""

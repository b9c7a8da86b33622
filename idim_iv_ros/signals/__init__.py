"""From a recording to filtered, decimated signals, all columns alike."""

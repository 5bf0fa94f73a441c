"""What a calibration leaves behind: its files, its summary and its page."""

"""What is seen: boards and targets, their points in pictures, and where pictures come from."""

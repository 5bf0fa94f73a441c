"""Views taken from live cameras, with guidance where to hold the board next."""

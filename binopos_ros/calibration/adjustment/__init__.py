"""The adjustment that all calibrations share: where it starts, what it finds, how well."""

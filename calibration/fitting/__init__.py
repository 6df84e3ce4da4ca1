"""The fit, its models, tests and errors."""

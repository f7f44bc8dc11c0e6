"""Tables in the documentation that come from the code."""

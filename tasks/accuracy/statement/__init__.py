"""From the tests at the points to what a standard lets one say."""

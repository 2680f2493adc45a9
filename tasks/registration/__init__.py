"""Stage `registration`: scans in one system, from control and from the targets that they share."""

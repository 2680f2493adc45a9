"""The report page with its charts and pictures, and the summary for programs."""

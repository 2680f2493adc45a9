"""What people read: the page, its charts and pictures, and the summary for programs."""

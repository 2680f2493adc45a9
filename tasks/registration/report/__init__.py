"""What the stage `registration` tells of the scans."""

"""What clients of the NodeODM contract download: products where WebODM looks for them, and everything else beside them."""

"""GeoTIFFs for the cloud: encoded level by level, in parts side by side, and put together without decoding them again."""

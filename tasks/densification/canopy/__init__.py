"""Heights of crowns from depth maps of single pairs, where no height of the volume goes along with its neighbours."""

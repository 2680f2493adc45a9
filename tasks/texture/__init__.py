"""The stage `texture`: the true orthoimage, blended from all photographs that see the ground."""

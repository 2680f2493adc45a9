"""From detected boards to an adjusted camera: initial values, bundle adjustment, choice of the distortion model."""

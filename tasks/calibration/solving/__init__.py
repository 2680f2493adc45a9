"""From detected boards to an adjusted camera: starting values, bundle, choice of the model."""

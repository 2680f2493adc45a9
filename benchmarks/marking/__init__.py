"""What marks in photographs are worth: wrong ones planted, targets drawn, time of an answer."""

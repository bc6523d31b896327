"""What the hand does: the motion and the object's true drift, in closed form."""

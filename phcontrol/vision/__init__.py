"""What a camera sees: projection, features and how they move with the arm, images and what is found in them."""

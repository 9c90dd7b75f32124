"""What modules and central send each other, and its bytes."""

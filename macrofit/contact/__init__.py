"""The interface: moments, the contact law, Newton's method, the two engines."""

"""Parts of pictures, and writing pictures to files."""

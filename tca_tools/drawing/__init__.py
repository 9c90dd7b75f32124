"""Parts of pictures, and how pictures become files."""

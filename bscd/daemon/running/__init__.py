"""What a job does: recipes as calls of procedures on the bench, and as programs of their own at the desk."""

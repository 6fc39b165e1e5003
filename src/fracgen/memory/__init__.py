"""What a training needs: memory, operations, time; and ways to need less of them."""

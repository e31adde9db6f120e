"""Training data: random bins, views, shards, batches, augmentation."""

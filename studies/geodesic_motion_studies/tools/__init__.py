"""What studies alone use: continuous geodesics, exact collision geometry, similarity of motions."""

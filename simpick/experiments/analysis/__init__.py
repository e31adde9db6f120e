"""Analysis of results: grasp scores, paired differences, causes of failure, tolerance to pose error."""

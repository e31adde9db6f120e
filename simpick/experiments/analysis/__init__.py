"""What results say: grasp scores, paired differences, causes of failure, tolerance to pose error."""

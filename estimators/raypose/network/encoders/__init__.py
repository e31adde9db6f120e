"""The image encoders E_I and the view encoder E_V."""

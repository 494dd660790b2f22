"""Cameras: GigE Vision and USB3 Vision through Aravis, V4L2 through OpenCV, and a folder of images played back."""

"""Thin rclpy nodes over the library; the only place that imports rclpy."""

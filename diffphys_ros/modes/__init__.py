"""Start values from the body's eigenmodes: forced frames, Young's modulus per part, damping, force. See start.py."""

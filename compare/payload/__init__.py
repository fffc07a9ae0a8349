"""What rides on the platform: a rigid body or a robot, and the leg forces that it takes to carry it."""

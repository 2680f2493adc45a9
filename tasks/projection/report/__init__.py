"""What the stage `projection` tells of outputs, surfaces and photographs."""

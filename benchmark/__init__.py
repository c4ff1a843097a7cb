"""Problems with impacts and dry friction, their reference values, and runners for programs that solve them."""

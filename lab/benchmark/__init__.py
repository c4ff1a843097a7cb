"""Problems with impacts and dry friction, their reference values, and the programs that solve them."""

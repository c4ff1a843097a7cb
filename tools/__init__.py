"""Programs that only this repository's Makefile and site call: demo, pictures, documents, builds and checks."""

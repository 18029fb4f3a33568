"""The page's program, style and licences as they are served: built from ``frontend``, see CONTRIBUTING."""

"""The page on which a comparison, or one panorama, is looked at: its data, its server, its one offline file."""

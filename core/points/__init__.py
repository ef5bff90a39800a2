"""Points: their fields, their neighbours, and what a constitutive law must offer."""

"""Physics of a finger on an electroadhesive touch screen: no devices, no driver."""

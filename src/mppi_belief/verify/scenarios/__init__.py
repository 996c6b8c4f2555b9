"""Problems with known answers on which the certificates are computed, and these answers."""

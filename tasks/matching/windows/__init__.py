"""How large a window matching needs: measures of texture, their limits, and maps of whole photographs."""

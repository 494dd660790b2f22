"""The lab jacks that raise and lower the biprism: by Modbus drives, or by hand."""
